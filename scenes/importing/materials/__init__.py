"""Materials that importers share: textures, MTL materials, measured spectra."""
