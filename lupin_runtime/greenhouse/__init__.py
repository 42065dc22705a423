"""The greenhouse's climate, read tag by tag from the package `mdp-greenhouse`."""
