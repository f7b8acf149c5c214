"""The loop that encoder, decoder and learning share: nodes in blocks, predicted and coded."""
