"""What every node of the suite is made of: executor, lifecycle, parameters, diagnostics, serialised messages."""
