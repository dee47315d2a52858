-- Who is to be audited, where no job waits or is under way.
SELECT name FROM audits_due
WHERE (SELECT material FROM jobs WHERE stage = 'pending' ORDER BY priority DESC, material LIMIT 1) IS NULL
    AND (SELECT material FROM leases ORDER BY material LIMIT 1) IS NULL
ORDER BY name
