"""The synthetic demo data set: objects modelled in code, scenes rendered on demand."""
