"""Readers of files: scenes of our own (`raybench`), and meshes with their materials (OBJ with MTL, PLY, STL)."""
