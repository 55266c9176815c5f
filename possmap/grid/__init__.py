"""The grid file ``*.possmap``: tiles, ledger and settings in one SQLite file (docs/grid-file.md).

What the rest of the program uses of it:

- ``grid.Grid(path, write=False)``, a context manager: ``is_new``, ``stored_settings()``,
  ``settings``, ``robots``, ``digest()``, ``transaction()``, ``snapshot()``, and, inside the
  transaction of the first fuse, ``prepare(settings, robots)``.
- ``Grid.ledger``: ``entry(name)``, ``entries()``, ``version(entry, most)``, ``geometry(entry)``,
  and ``add(rows.excursion_rows(...))``.
- ``Grid.ledger.came``: ``add(arrivals, fused_at, version)`` takes an ``arrivals.Arrival`` for
  everything that a file held, new or not, and leaves out what is noted already; ``of(name)``,
  ``all()``, and ``arrivals.with_news``, which tells what of it was new.
- ``Grid.ledger.forgotten``: ``all()``, to be asked through ``forgotten.Bans``.
- ``Grid.tiles``: ``packed(key)`` and ``put(key, packed)``; any process may call
  ``encoding.unpacked`` and ``encoding.encode`` on what is between the two.
- ``replay.replay(grid, entry, settings)`` lays out an excursion of the ledger again, and
  ``replay.remade`` makes tiles of the ledger.
- ``soundness.Soundness(grid)`` and ``Grid.database.check_structure()`` look for faults.
"""
