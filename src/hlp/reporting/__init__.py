"""Results for people: tables, figures and MLflow. No other package imports mlflow."""
