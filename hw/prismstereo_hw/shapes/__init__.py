"""Things a scene can hold: each says where rays meet it, which way it faces there, what it looks like, how it moves."""
