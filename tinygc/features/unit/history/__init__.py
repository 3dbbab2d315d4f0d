"""One unit over its sessions."""
