#pragma once
/// Patches that are as large as light and reflectance allow: a first solution on coarse ones shows where light that a patch's mean would
/// put at other places of it matters.
#include "libradiosity/field.h"
#include "libscene/texels.h"

namespace lmc {

/// `coarsest`: with the size of the largest patches and how often it may be halved; its `light` is found here. `map` has the texels' direct
/// light. Before exposePatches, as makePatches leaves them.
PatchMesh makeAdaptivePatches(const Scene&, const Tracer&, const DirectLight&, const DirectMap& map, const TexelMap&,
                              const PatchOptions& coarsest, const Run&);

}  // namespace lmc
