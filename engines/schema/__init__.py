"""Files that people write: strict YAML with places (`yaml_file`), and descriptions of keys (`keys`) that read and explain it.

A description gives a key's kind, meaning, unit and default once. It reads a tree of `yaml_file.Located` into checked values,
every refusal with file, line and dotted path, and it makes the JSON schema, from which the reference page comes.
"""
