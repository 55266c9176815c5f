-- Format 4 of a possmap grid: one SQLite file (docs/grid-file.md).
-- application_id 0x506F7373 ("Poss"), user_version 4. STRICT: SQLite looks to the types, also of a file that somebody else wrote.

-- The settings that shape evidence, and what is known of single robots (robots.NAME.PARAMETER). JSON values.
CREATE TABLE setting (
    name  TEXT PRIMARY KEY,
    value TEXT NOT NULL
) STRICT, WITHOUT ROWID;

-- The files that came, in the order of arrival. Outside the digest.
CREATE TABLE source (
    id       INTEGER PRIMARY KEY,
    name     TEXT NOT NULL,      -- as the user gave it
    sha256   TEXT NOT NULL,      -- of the bytes as delivered
    size     INTEGER NOT NULL,   -- of the same
    fused_at TEXT NOT NULL,      -- UTC, ISO 8601
    version  TEXT NOT NULL       -- of possmap
) STRICT;

-- One robot's outings, each known so far.
CREATE TABLE excursion (
    id        INTEGER PRIMARY KEY,
    robot     TEXT NOT NULL,
    name      TEXT NOT NULL,
    own_model TEXT NOT NULL,     -- JSON: the log's own parameters, as delivered
    model     TEXT NOT NULL,     -- JSON: all parameters in force, since its first fuse
    records   INTEGER NOT NULL,  -- how many are known
    hash      BLOB NOT NULL,     -- of names, model in force and records
    extra     TEXT NOT NULL,     -- JSON: the log's x_ keys, or empty
    beyond    INTEGER NOT NULL,  -- how many records say nothing: the error there reaches max_error
    used      INTEGER NOT NULL,  -- observations of the heading (estimator walls) that told it,
    vague     INTEGER NOT NULL,  -- might have meant another of the axes,
    outliers  INTEGER NOT NULL,  -- contradicted the rest,
    seen      INTEGER NOT NULL,  -- how many of those used were seen in passing,
    residuals REAL NOT NULL,     -- and the sum of r/√V over them
    fixes      INTEGER NOT NULL, -- fixes that told its place,
    surprising INTEGER NOT NULL, -- how many of them surprised,
    surprise   REAL NOT NULL,    -- and the largest of their rᵀV⁻¹r
    UNIQUE (robot, name)
) STRICT;

-- Which file held how many records of an excursion, in the order of arrival. Outside the digest.
CREATE TABLE arrival (
    id                INTEGER PRIMARY KEY,
    excursion         INTEGER NOT NULL REFERENCES excursion (id),
    source            INTEGER NOT NULL REFERENCES source (id),
    records           INTEGER NOT NULL,  -- from the first on
    carrier_robot     TEXT,      -- whose log carried it; NULL: the robot's own
    carrier_excursion TEXT
) STRICT;
CREATE INDEX arrival_of_excursion ON arrival (excursion);

-- Every record as logged, and beside it where it lies on the map (map_…, metres and degrees, and
-- half-widths in metres); NULL there: it waits for a pose, or is a meeting.
CREATE TABLE record (
    excursion INTEGER NOT NULL REFERENCES excursion (id),
    number    INTEGER NOT NULL,  -- from 0, in the order of seq
    kind      TEXT NOT NULL,
    {fields},
    map_x     REAL, map_y REAL, half_x REAL, half_y REAL,
    map_x2    REAL, map_y2 REAL, half_x2 REAL, half_y2 REAL,
    map_heading REAL,
    PRIMARY KEY (excursion, number)
) STRICT, WITHOUT ROWID;

-- The tiles that a record touches.
CREATE TABLE touched (
    tile_row    INTEGER NOT NULL,
    tile_column INTEGER NOT NULL,
    excursion   INTEGER NOT NULL REFERENCES excursion (id),
    number      INTEGER NOT NULL,
    PRIMARY KEY (tile_row, tile_column, excursion, number)
) STRICT, WITHOUT ROWID;

-- What is known of each tile of 256 × 256 cells that is not pure ignorance. Layer 0: weights of
-- walls, 1: denials of walls, 2: weights of singular points. Rows and columns row0 … row1 - 1 of the
-- tile hold all that is not 0.
CREATE TABLE tile (
    id       INTEGER PRIMARY KEY,
    layer    INTEGER NOT NULL,
    row      INTEGER NOT NULL,
    "column" INTEGER NOT NULL,
    row0     INTEGER NOT NULL, row1 INTEGER NOT NULL,
    column0  INTEGER NOT NULL, column1 INTEGER NOT NULL,
    hash     BLOB NOT NULL,
    UNIQUE (layer, row, "column")
) STRICT;

-- The numbers themselves, apart, so that hashes and bounds are read without them.
CREATE TABLE cells (
    tile INTEGER PRIMARY KEY REFERENCES tile (id),
    data BLOB NOT NULL
) STRICT;

-- What was taken out, and is not let in. Either a robot, or one excursion of it, or what a file
-- brought. Outside the digest.
CREATE TABLE forgotten (
    id           INTEGER PRIMARY KEY,
    robot        TEXT,              -- NULL: a file
    excursion    TEXT,              -- NULL: all of the robot's, or a file
    source       TEXT,              -- the file's name as in source; NULL: a robot
    sha256       TEXT,              -- of its bytes, by which it is known again
    excursions   INTEGER NOT NULL,  -- of how many excursions something was taken out
    records      INTEGER NOT NULL,  -- and how many records
    forgotten_at TEXT NOT NULL,     -- UTC, ISO 8601
    version      TEXT NOT NULL      -- of possmap
) STRICT;
CREATE UNIQUE INDEX forgotten_once ON forgotten (coalesce(robot, ''), coalesce(excursion, ''), coalesce(sha256, ''));
