-- What format 2 adds to format 1: deliveries of what was known, and what was forgotten.

-- Files that held records of an excursion which were all known when they came. Outside the digest.
CREATE TABLE again (
    excursion         INTEGER NOT NULL REFERENCES excursion (id),
    source            INTEGER NOT NULL REFERENCES source (id),
    count             INTEGER NOT NULL,  -- how many records it held, from the first
    carrier_robot     TEXT,              -- whose log carried them; NULL: the robot's own
    carrier_excursion TEXT,
    PRIMARY KEY (excursion, source)
) WITHOUT ROWID;

-- What brought an excursion, without a look at every part.
CREATE INDEX part_of_excursion ON part (excursion);

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
);
