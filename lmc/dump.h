#pragma once
/// What a bake made on its way, to look at: asked for by `lmc bake --dump`.
#include "libscene/files.h"
#include "lmc/stages.h"

namespace lmc {

/// patches.obj, the faces of patches with a group each, and patches.png, the map's texels in the colours of their patches: the brighter the
/// finer. commit() is left to the caller.
void dumpPatches(OutputSet&, const Bake&);

/// seams.png: the map in grey, and in it the texels at smooth seams in the colour of the largest difference of bilinear lookups across the
/// seam there, against the light: left before, right after closing. Blue 0, green 1 %, yellow 3 %, red 10 % and more.
void dumpSeams(OutputSet&, const Bake&);

}  // namespace lmc
