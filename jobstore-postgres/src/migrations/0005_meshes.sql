-- The bytes of the file of a sample's mesh, in parts: a specification names it by its digest.
CREATE TABLE meshes (
    digest bytea NOT NULL,
    part integer NOT NULL,
    bytes bytea NOT NULL,
    PRIMARY KEY (digest, part)
);
