"""Registry of the export formats: `pbrnet export-data --to` and its help follow from it."""

from __future__ import annotations

from pbrnet.pipeline.export import coco, colmap, hypersim, nerfstudio, renderformer, tum, webdataset

FORMATS = {
    form.name: form
    for form in (
        nerfstudio.FORMAT,
        colmap.FORMAT,
        coco.INSTANCES,
        coco.PANOPTIC,
        webdataset.FORMAT,
        hypersim.FORMAT,
        tum.FORMAT,
        renderformer.FORMAT,
    )
}
