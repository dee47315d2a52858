SELECT sum(completed + disputed)::bigint FROM tallies
