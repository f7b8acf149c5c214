"""What a library teaches: motion models, their bytes, and sketches of clips."""
