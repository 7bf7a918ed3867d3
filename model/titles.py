"""Titles of methods and networks, for reports, studies, help texts and model cards."""

from pbrnet.model.methods import BASELINES, METHODS

# Methods, as named in tables and plots of results.
METHOD_TITLES = {
    "pbrnet": "Both networks (shading, then composition)",
    "product": "Reflectance × predicted shading",
    "product_linear": "Reflectance × predicted shading, projected linearly",
    **{name: METHODS[name].title for name in ("plus", "hybrid")},
    "denoised": "The same samples, denoised (no network of ours)",
    "radiosity": "Radiosity: light transport without paths, denoised",
    **{name: METHODS[name].title for name in BASELINES},
    "ceiling": "Reflectance × true shading, the upper bound of the product",
}
# Networks, as named in learning curves, example pictures, help texts and model cards.
NETWORK_TITLES = {name: method.network_title for name, method in METHODS.items()}
