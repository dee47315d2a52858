-- Ranges do not overlap, and all of them together are a window of few materials.
SELECT material, record, coalesce(leases.views_done, 0)
FROM unnest($1::bigint[], $2::bigint[]) AS ranges (first, last)
    JOIN jobs ON material BETWEEN first AND last
    LEFT JOIN leases USING (material)
WHERE stage = ANY ($3::text[]::stage[])
ORDER BY material
LIMIT $4
