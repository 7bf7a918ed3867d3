"""The methods that PBR-Net is compared with, each in one file to be read beside its paper."""
