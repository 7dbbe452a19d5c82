"""What brings records into MLflow; mlflow itself in store.py alone."""
