-- Whether nothing is left to do, and whether nothing is disputed that somebody could be asked about.
-- Ordered, so that the answer comes from the start of an index: most rows are of one stage, and
-- which one they are of at the start of the table is not known.
SELECT (SELECT material FROM jobs WHERE stage = 'pending' ORDER BY priority DESC, material LIMIT 1) IS NULL
    AND (SELECT material FROM leases ORDER BY material LIMIT 1) IS NULL
    AND (
        SELECT material FROM jobs
        WHERE judge_wanted AND EXISTS (
            SELECT FROM able
            WHERE jobs.renderer <> able.identity
                AND jobs.contradictor IS DISTINCT FROM able.identity
                AND NOT able.name = ANY (jobs.failed_on)
                AND (jobs.stage = 'disputed' OR able.identity <> 'operator/')
        )
        ORDER BY stage DESC, material
        LIMIT 1
    ) IS NULL
    AND NOT EXISTS (SELECT FROM audits_due)
