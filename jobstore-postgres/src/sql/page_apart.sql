-- Stages that few jobs are in have an index of their own.
SELECT material, record, coalesce(leases.views_done, 0)
FROM unnest($1::text[]::stage[]) AS wanted (stage)
    CROSS JOIN LATERAL (
        SELECT material, record FROM jobs
        WHERE jobs.stage = wanted.stage AND jobs.stage IN ('disputed', 'set_aside', 'cancelled')
            AND material >= $2
        ORDER BY material
        LIMIT $3
    ) AS apart
    LEFT JOIN leases USING (material)
ORDER BY material
LIMIT $3
