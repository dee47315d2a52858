SELECT material FROM leases
