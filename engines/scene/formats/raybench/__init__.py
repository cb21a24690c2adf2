"""The YAML of scenes: `scene` describes the file, and beside it are its cameras, materials, shapes and lights."""
