UPDATE farm SET migrating_from = NULL
