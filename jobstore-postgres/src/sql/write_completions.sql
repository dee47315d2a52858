INSERT INTO completions (material, completion)
SELECT * FROM unnest($1::bigint[], $2::text[])
ON CONFLICT (material) DO UPDATE SET completion = excluded.completion
