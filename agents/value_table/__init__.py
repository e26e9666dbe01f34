"""The cost to come as a table over motions and stretches, and the policy that looks it up."""
