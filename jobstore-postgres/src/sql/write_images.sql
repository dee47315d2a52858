INSERT INTO images (digest, material, view, bytes)
SELECT * FROM unnest($1::bytea[], $2::bigint[], $3::integer[], $4::bigint[])
ON CONFLICT (digest) DO UPDATE
SET material = excluded.material, view = excluded.view, bytes = excluded.bytes
