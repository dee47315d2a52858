-- Ranges do not overlap, and all of them together are a window of few materials: told apart from
-- them, so that no more of the index is read.
SELECT material, record, coalesce(leases.views_done, 0)
FROM unnest($1::bigint[], $2::bigint[]) AS ranges (first, last)
    JOIN jobs ON material BETWEEN first AND last
    LEFT JOIN leases USING (material)
WHERE stage = ANY ($3::text[]::stage[])
    AND material BETWEEN ($1::bigint[])[1] AND ($2::bigint[])[cardinality($2::bigint[])]
ORDER BY material
LIMIT $4
