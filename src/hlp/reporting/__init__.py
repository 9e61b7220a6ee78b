"""What people see of a run: MLflow, tables and pictures. The only package that imports mlflow."""
