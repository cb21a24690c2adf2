"""Runs: references and certificates are made, cells measured by an executor, and every event recorded as it happens."""
