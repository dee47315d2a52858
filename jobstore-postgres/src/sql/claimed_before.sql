SELECT material, token FROM leases WHERE worker = ANY ($1) AND token = ANY ($2)
