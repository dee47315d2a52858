SELECT material FROM leases WHERE worker = $1
