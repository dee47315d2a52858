SELECT sum(pending)::bigint, sum(leased)::bigint, sum(completed)::bigint, sum(disputed)::bigint,
    sum(set_aside)::bigint, sum(cancelled)::bigint, sum(checks)::bigint,
    (SELECT mode FROM farm), (SELECT count(*) FROM workers WHERE barred)
FROM tallies
