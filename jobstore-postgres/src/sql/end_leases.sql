DELETE FROM leases WHERE material = ANY ($1)
