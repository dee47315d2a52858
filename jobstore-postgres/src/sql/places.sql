SELECT digest, material, view, bytes FROM images WHERE digest = ANY ($1)
