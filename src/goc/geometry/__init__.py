"""Pure maths on arrays: rays, rotations, planes, neighbours, ray casting, topology of meshes."""
