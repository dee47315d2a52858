SELECT mode, now_ms(), counts.pending, counts.redundant
FROM farm, (
    SELECT sum(pending)::bigint AS pending, sum(checks + disputed)::bigint AS redundant FROM tallies
) AS counts
