"""Classical controllers, one a module, each with its entry for tables and commands."""
