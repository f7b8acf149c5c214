"""What an archive knows about its clips."""
