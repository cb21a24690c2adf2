"""The report: one HTML file that needs no network, its pictures, and the scripts and styles that go into it."""
