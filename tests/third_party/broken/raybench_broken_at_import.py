"""Cannot be imported."""

raise RuntimeError("the driver is from 1997")
