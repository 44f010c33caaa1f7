"""Speed, always beside a straightforward NumPy version in the same run."""
