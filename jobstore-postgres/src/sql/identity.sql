SELECT renderer_version, specification_hash, specification, blobs, migrating_from FROM farm
