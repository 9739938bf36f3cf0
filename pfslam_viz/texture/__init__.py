"""The floor texture map: section K of the paper."""
