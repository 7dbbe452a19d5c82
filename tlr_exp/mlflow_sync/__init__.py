"""Brings records into MLflow; mlflow itself is imported in store.py alone."""
