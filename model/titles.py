"""Titles of methods and networks, for reports, studies, help texts and model cards."""

# Methods, as named in tables and plots of results.
METHOD_TITLES = {
    "pbrnet": "Both networks (shading, then composition)",
    "product": "Reflectance × predicted shading",
    "product_linear": "Reflectance × predicted shading, projected linearly",
    "plus": "PBR-Net plus: our network without samples",
    "hybrid": "PBR-Net hybrid: a few samples a pixel, denoised, corrected by a network",
    "denoised": "The same samples, denoised; no network of ours",
    "radiosity": "Radiosity: light transport without paths, denoised; no network of ours",
    "unet": "One direct U-Net",
    "end_to_end": "Both networks, trained on colour alone",
    "can": "CAN, trained with our loss",
    "can_own": "CAN, with its own loss: mean squares",
    "pix2pix": "pix2pix's generator, trained with our loss",
    "pix2pix_own": "pix2pix, with its own loss: adversarial and L1",
    "cyclegan": "CycleGAN's generator, trained with our loss",
    "cyclegan_own": "CycleGAN, with its own loss: unpaired, adversarial and cycles",
    "ceiling": "Reflectance × true shading: what the product could reach at best",
}
# Networks, as named in learning curves, example pictures, help texts and model cards.
NETWORK_TITLES = {
    "shading": "Shading network",
    "composition": "Composition network",
    "plus": "PBR-Net plus",
    "hybrid": "PBR-Net hybrid",
    "unet": "Direct U-Net",
    "end_to_end": "Both networks, on colour alone",
    "can": "CAN, our loss",
    "can_own": "CAN, its own loss",
    "pix2pix": "pix2pix, our loss",
    "pix2pix_own": "pix2pix, its own loss",
    "cyclegan": "CycleGAN, our loss",
    "cyclegan_own": "CycleGAN, its own loss",
}
