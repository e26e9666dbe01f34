"""The environments of Gymnasium, single and vector, and the registered tasks."""
