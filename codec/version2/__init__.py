"""Index files of version 2: from a clip to bytes inside its limits, and back."""
