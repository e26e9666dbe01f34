"""Gymnasium environments, single and vector, and the registration of the tasks."""
