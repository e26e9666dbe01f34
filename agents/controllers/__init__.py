"""Classical control laws, one a module, and the protocol that all controllers follow."""
