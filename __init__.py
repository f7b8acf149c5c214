"""motifold: folds a motion-capture library into its motifs and gives every clip back."""
