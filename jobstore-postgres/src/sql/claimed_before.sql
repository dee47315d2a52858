SELECT material, token FROM leases WHERE worker = $1 AND token = ANY ($2)
