INSERT INTO meshes (digest, part, bytes)
SELECT $1, $2, $3 WHERE EXISTS (SELECT FROM farm WHERE specification_hash = $4)
ON CONFLICT (digest, part) DO NOTHING
