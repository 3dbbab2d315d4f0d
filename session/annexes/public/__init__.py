"""Public recordings as session folders, from their authors' own files."""
