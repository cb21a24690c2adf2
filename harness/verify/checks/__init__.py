"""The cases of the suite, one module a subject; each module has a `SECTION` that holds its cases."""
