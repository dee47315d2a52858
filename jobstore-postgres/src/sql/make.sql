INSERT INTO farm (renderer_version, specification_hash, specification, blobs, migrating_from)
VALUES ($1, $2, $3, $4, $5)
ON CONFLICT (one) DO UPDATE SET specification = excluded.specification
WHERE farm.specification_hash = excluded.specification_hash
