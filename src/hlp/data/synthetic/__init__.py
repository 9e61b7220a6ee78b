"""The embedded demo: objects modelled in code, scenes rendered on demand."""
