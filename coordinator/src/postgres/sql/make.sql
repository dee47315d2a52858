INSERT INTO farm (renderer_version, specification_hash, specification, blobs)
VALUES ($1, $2, $3, $4)
ON CONFLICT (one) DO UPDATE SET specification = excluded.specification
WHERE farm.specification_hash = excluded.specification_hash
