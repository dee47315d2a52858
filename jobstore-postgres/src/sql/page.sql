SELECT material, record, coalesce(leases.views_done, 0)
FROM jobs LEFT JOIN leases USING (material)
WHERE material >= $1 AND stage = ANY ($2::text[]::stage[])
    AND ($3::bigint[] = '{}' OR EXISTS (
        SELECT FROM unnest($3::bigint[], $4::bigint[]) AS ranges (first, last)
        WHERE material BETWEEN first AND last
    ))
ORDER BY material
LIMIT $5
