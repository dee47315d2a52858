-- The store that this one is being made a copy of, while not all of it is here.
ALTER TABLE farm ADD COLUMN migrating_from text;
