"""Default materials of Java 3D, for models without an MTL file.

One line each: name, diffuse colour, highlight (mean specular colour, 0 for none), exponent,
opacity. Colours are sRGB values. A material with an opacity below 1 is glass.
"""

from __future__ import annotations

_TABLE = """
amber .5755 .2678 0 .3 60 1
amber_trans .5755 .2678 0 .3 60 .16
aqua 0 .5 .5 .5673 60 1
aqua_filter .3743 .6694 .5791 .1878 91.47 .02
archwhite .9959 .9959 .9959 0 0 1
archwhite2 .8408 .8408 .8408 0 0 1
bflesh .0245 .0081 .0021 .0381 20.16 1
black .002 .002 .002 .5184 157.36 1
blondhair .5714 .3283 .0443 .4425 4.65 1
blue_pure 0 0 1 .1667 65.89 1
bluegrey .1881 .2786 .2898 .3 14.73 1
bluetint .0468 .7115 .9551 .3184 60 .43
bluteal .0776 .2571 .2041 .13 25 1
blugrn .0811 .6408 .2775 .13 25 1
blutan .0776 .2571 .2041 .13 25 1
bone .9 .7626 .4261 .7353 200 1
bone1 .9837 .7959 .4694 0 0 1
bone2 .9837 .862 .6504 0 0 1
brass .4776 .1959 0 .5796 134.88 1
brnhair .0898 .0302 .011 .0826 60.47 1
bronze .0653 .0367 .0122 .0395 137.21 1
brown .0857 .0147 0 .0624 65.89 1
brownlips .1429 .0653 .0408 .3 25 1
brownskn .0204 .0082 0 .0521 20.16 1
brzskin .3796 .2898 .2122 .3 25 1
chappie .5837 .1796 .0367 .3 60 1
charcoal .0041 .0041 .0041 .3 60 1
deepgreen 0 .0204 .005 .3 113.18 1
default .7102 .702 .6531 .3 128 1
dkblue 0 .0041 .0571 .3 60 1
dkblue_pure 0 0 .1347 .1891 65.89 1
dkbrown .0087 .0038 .0016 .2113 60 1
dkdkgrey .0122 .0122 .0122 .3 60 1
dkgreen .0058 .0245 0 .0163 60 1
dkgrey .049 .049 .049 .3 60 1
dkorange .7143 .035 0 .2657 65.89 1
dkpurple .0245 0 .049 .1266 65.89 1
dkred .2286 0 0 .083 60 1
dkteal 0 .0653 .0449 .3 55.04 1
emerald .047 1 0 .2 60 .25
fgreen 0 .0449 .0004 .0252 106.2 1
flaqua 0 .5 .5 0 0 1
flblack .0041 .0041 .0041 0 0 1
flblonde .5714 .3283 .0443 0 0 1
flblue_pure 0 0 .7102 0 0 1
flbrown .1102 .012 .0013 0 0 1
fldkblue_pure 0 0 .1347 0 0 1
fldkdkgrey .0122 .0122 .0122 0 0 1
fldkgreen .0058 .0245 0 0 0 1
fldkgreen2 .0245 .0694 .0041 0 0 1
fldkgrey .0939 .0939 .0939 0 0 1
fldkolivegreen .0151 .0204 .0038 0 0 1
fldkpurple .1612 0 .3347 0 13.95 1
fldkred .2286 .0082 .0082 0 0 1
flesh .5265 .4127 .3374 .3 60 1
fleshtransparent .6898 .2942 .1295 .5539 6.2 .25
flgrey .5 .5 .5 0 0 1
fllime 0 1 0 0 0 1
flltbrown .2776 .1143 .0531 0 0 1
flltgrey .8245 .8245 .8245 0 0 1
flltolivegreen .0393 .0531 .01 0 0 1
flmintgreen .1306 .2898 .1673 0 0 1
flmustard .8898 .3531 .0073 0 0 1
florange 1 .1667 0 0 0 1
flpinegreen .1061 .2163 .0857 0 0 1
flpurple .3755 0 .751 0 0 1
flred 1 0 0 0 0 1
fltan .6612 .4567 .1295 0 0 1
flwhite .9837 .9309 .8392 .7027 200 1
flwhite1 1 1 1 0 0 1
flyellow 1 .6667 0 0 0 1
glass .4873 .4919 .5306 .7452 200 1
glassblutint .5551 .8 .773 .8969 60 .67
glasstransparent .4694 .4694 .4694 .6082 200 .25
gold 1 .4898 0 .4858 123.26 1
green 0 .25 0 .0833 65.89 1
greenskn 0 .0735 0 .0871 46.51 1
grey .1837 .1837 .1837 .5 65.89 1
hair .0008 .0007 .0006 0 60 1
iris 0 .0572 .3184 .5433 188.37 1
jetflame .951 .4939 .098 .4584 132.56 1
lavendar .2187 .0906 .3469 .3 60 1
lcdgreen .5878 1 .5061 .3 60 1
lighttan .702 .421 .2206 .7398 177.52 1
lighttan2 .3143 .187 .0962 .7398 177.52 1
lighttan3 .1796 .0829 .0139 .7398 177.52 1
lighttannew .7878 .607 .3216 .7398 177.52 1
lightyellow 1 .9542 .3388 .6353 177.52 1
lime 0 1 0 .1667 65.89 1
lips .9265 .2612 .2898 .3 25 1
ltbrown .2776 .1143 .0531 .1603 60 1
ltgrey .3837 .3837 .3837 .5 65.89 1
meh .5551 .8 .773 .8969 183.72 .25
metal .9 .7626 .4261 .8821 200 1
mintgrn .0245 .4776 .0816 .1946 65.89 1
muscle .4204 .0721 .0856 .1184 25.58 1
navy_blue 0 0 .0531 .1878 91.47 1
offwhite.cool .8367 .6812 .5703 .3 60 1
offwhite.warm .8367 .6898 .449 .3 60 1
olivegreen .025 .0367 0 .2067 97.67 1
orange 1 .1667 0 .3889 65.89 1
pale_green .0712 .3796 .049 .1878 91.47 1
pale_pink .6531 .2053 .416 .1878 91.47 1
pale_yellow .6898 .6211 .1999 .1878 91.47 1
peach .6367 .1829 .0156 .1878 91.47 1
periwinkle 0 .0396 .8286 .1878 91.47 1
pink .9878 .1695 .6702 .4458 106.2 1
pinktan .6857 .2571 .2163 .13 25 1
plasma 1 .0776 .4478 .3 60 .25
purple .5 0 1 .5 65.89 1
red .7714 0 0 .2952 136.43 1
redbrick .3306 .0398 .0081 0 0 1
redbrown .2816 .006 0 .3714 141.09 1
redorange .7551 .0185 0 .3195 132.56 1
redwood .2571 .033 0 .1878 91.47 1
rubber .01 .01 .01 .1 65.89 1
ruby 1 0 0 .2 60 .25
sand_stone .1256 .1138 .0965 .2113 60 1
sapphire .0235 0 1 .2 60 .25
shadow .035 .0248 .0194 0 0 .25
ship2 1 1 1 .1143 60 1
silver .6163 .6163 .6163 .3 60 1
skin .1102 .0328 .0139 .3 17.83 1
sky_blue .1241 .5931 .8 .049 13.95 1
smoked_glass .0041 .0041 .0041 .1878 91.47 .02
tan .6612 .5221 .2186 .3747 60 1
taupe .2041 .1227 .1058 .3 84.5 1
teeth .9837 .7959 .4694 0 0 1
violet .0287 .0269 .1347 .4472 96.9 1
white 1 1 1 .3 60 1
yellow 1 .6667 0 .5556 65.89 1
yellow_green .1875 .4082 .0017 .1878 91.47 1
yellowbrt 1 .7837 0 .3 60 1
yelloworng .8857 .249 0 .3 60 1
"""


def _parsed() -> dict[str, tuple[float, ...]]:
    rows = (line.split() for line in _TABLE.split("\n") if line)
    return {row[0]: tuple(float(value) for value in row[1:]) for row in rows}


# Name -> (red, green, blue, highlight, exponent, opacity).
DEFAULT_MATERIALS: dict[str, tuple[float, ...]] = _parsed()
