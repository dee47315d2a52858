-- As page.sql.
SELECT material, record
FROM unnest($1::bigint[], $2::bigint[]) AS ranges (first, last)
    JOIN jobs ON material BETWEEN first AND last
WHERE stage = ANY ($3::text[]::stage[])
    AND material BETWEEN ($1::bigint[])[1] AND ($2::bigint[])[cardinality($2::bigint[])]
ORDER BY material
FOR UPDATE OF jobs
