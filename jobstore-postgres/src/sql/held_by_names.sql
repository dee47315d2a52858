SELECT material FROM leases WHERE name = ANY ($1)
