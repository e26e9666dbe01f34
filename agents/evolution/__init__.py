"""Evolution: small networks that begin as a law, searched as whole populations over lanes."""
