-- As page.sql.
SELECT material, record
FROM unnest($1::bigint[], $2::bigint[]) AS ranges (first, last)
    JOIN jobs ON material BETWEEN first AND last
WHERE stage = ANY ($3::text[]::stage[])
ORDER BY material
FOR UPDATE OF jobs
