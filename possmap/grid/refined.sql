-- What a refined grid holds besides (docs/refine.md); no other grid has these tables.

-- One row: what it was made of, and how.
CREATE TABLE refinement (
    made_of TEXT NOT NULL,       -- the digest of the grid that it was made of
    robots  TEXT NOT NULL        -- JSON: whose tracks were to be moved; none: all
) STRICT;

-- The tracks that were moved; of other excursions the estimator tells where they lie.
CREATE TABLE refined (
    excursion INTEGER PRIMARY KEY REFERENCES excursion (id),
    track     BLOB NOT NULL      -- of each pose x, y, half_x, half_y [m], heading error, H [rad]
) STRICT;
