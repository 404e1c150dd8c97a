#pragma once
/// Which share of the light between two patches gets through.
#include "libradiosity/patch_mesh.h"
#include "libscene/rng.h"
#include "libscene/run.h"
#include "libscene/tracer.h"

namespace lmc {

/// The corners of a leaf in the level [m], counter-clockwise seen from the side that the patch stands for.
std::array<glm::dvec3, 3> leafCorners(const Scene&, const Leaf&, bool back);

/// A ray from the patch, cosine-distributed about its face: u.xy is the direction, u.zw the place. Of a patch that is partly buried, from
/// one of its exposed places, which `places` numbers: the rest lies inside solids and is not in its area.
Ray exposedRay(const Scene&, const Tracer&, const PatchMesh&, const Patch&, const glm::vec4& u, const Sobol4& places);

/// False when no place of one patch is in front of any place of the other: no form factor, no ray. Takes patches as flat within half their
/// radius.
bool mayFace(const Patch&, const Patch&);

/// sum K V / sum K over scrambled Sobol pairs of places, K the point-to-point kernel: unbiased where penumbrae are not (a plain share of
/// clear rays is off by up to 7 %). 16 pairs; 64 when they disagree. In [0, 1].
double visibleShare(const Scene&, const Tracer&, const PatchMesh&, std::uint32_t i, std::uint32_t j, const Run&);

}  // namespace lmc
