-- $3 of the completions that an identity alone vouches for, drawn by a random seed.
SELECT material FROM jobs
WHERE renderer = $1 AND stage = 'completed' AND NOT judge_wanted
    AND NOT EXISTS (SELECT FROM leases WHERE leases.material = jobs.material)
ORDER BY hashint8extended(material, $2), material
LIMIT $3
