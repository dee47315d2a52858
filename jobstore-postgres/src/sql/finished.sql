-- Ordered, so that the answer comes from the start of an index: most rows are of one stage, and
-- which one they are of at the start of the table is not known.
SELECT (SELECT material FROM jobs WHERE stage = 'pending' ORDER BY priority DESC, material LIMIT 1) IS NULL
    AND (SELECT material FROM leases ORDER BY material LIMIT 1) IS NULL
    AND (SELECT material FROM jobs WHERE stage = 'disputed' ORDER BY material LIMIT 1) IS NULL
    AND (
        SELECT material FROM jobs
        WHERE judge_wanted AND stage = 'completed' AND EXISTS (
            SELECT FROM able WHERE jobs.renderer <> able.name AND NOT able.name = ANY (jobs.failed_on)
        )
        ORDER BY stage DESC, material
        LIMIT 1
    ) IS NULL
