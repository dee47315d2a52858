SELECT name FROM workers
WHERE failing AND name = ANY (ARRAY(SELECT name FROM leases WHERE material = ANY ($1)))
