SELECT mode, now_ms(), counts.pending, counts.judged
FROM farm, (
    SELECT sum(pending)::bigint AS pending, sum(checks + disputed)::bigint AS judged FROM tallies
) AS counts
