SELECT material FROM leases WHERE name = ANY ($1) OR identity(name) = ANY ($1)
