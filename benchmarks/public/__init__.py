"""Public sets of recordings as session folders, from their authors' own files (docs/real-recordings.md)."""
