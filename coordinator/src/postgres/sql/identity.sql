SELECT renderer_version, specification_hash, specification, blobs FROM farm
