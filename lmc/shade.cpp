#include "lmc/shade.h"

#include <fmt/format.h>

#include "libscene/parallel.h"
#include "lmc/bake.h"
#include "lmc/progress.h"
#include "lmc/shade_level.h"
#include "lmc/shade_picture.h"
#include "shaders/oracle.h"
#include "shaders/reference.h"

namespace lmc {

namespace {

using shaders::Frame;
using shaders::Target;

void ignoreDeterminants(ShadingLevel& level) {
  for (glm::vec4& t : level.tangents)
    if (t.w != 0.0f) t.w = 1.0f;
}

}  // namespace

Exit shade(const ShadeOptions& options) {
  const bool linear = options.picture.extension() == ".exr";
  if (!linear && options.picture.extension() != ".png")
    throw Error(Exit::Usage, "lmc", "", "shade: -o takes a name that ends in .png or .exr");
  if (!options.shaderDir.empty() && !std::filesystem::is_directory(options.shaderDir))
    throw Error(Exit::Io, options.shaderDir, "", "is no folder");
  const Run run = stoppableRun(options.threads);
  LoadedLevel loaded = loadForShader(options.out, options.camera, run);
  if (!options.determinants) ignoreDeterminants(loaded.level);

  shaders::View view;
  view.camera = cameraFor(loaded.level.scene, options.camera);
  view.width = options.width;
  view.height = options.height;
  view.exposure = options.exposure > 0.0 || !linear ? options.exposure : 1.0;
  view.toneCurve = options.reinhard ? shaders::ToneCurve::Reinhard : shaders::ToneCurve::None;
  view.encode = !linear;
  view.lightMap = options.lightMap;
  view.bakedAo = options.bakedAo;
  const bool darkens = shaders::hasAmbient(loaded.level);
  if (options.screenAo && !darkens)
    tell(fmt::format("{}\n",
                     line("note", options.out.string(), "",
                          "has no ambient light, which is all that screen-space occlusion darkens: it is left out", "LMC_NO_AMBIENT")));
  view.screenAo = (options.screenAo && darkens) || options.view == "screen-ao";
  view.normalMaps = options.normalMaps;
  const Looked looked = lookedAt(options.view);
  view.only = looked.target;

  Frame frame;
  if (options.oracle)
    withThreads(run, [&] { frame = shaders::renderOracle(loaded.level, loaded.maps, view, run); });
  else
    frame = shaders::Reference(loaded.level, loaded.maps).render(view, shaders::ShaderChoice::all(options.shaderDir));

  const bool finished = looked.target == Target::Picture;
  if (linear)
    writeLinear(options.picture, finished ? frame[Target::Picture] : rawPicture(frame, looked, view.exposure));
  else
    writePng(options.picture, quantised(finished ? frame[Target::Picture] : shownPicture(frame, looked, options.exposure)));
  return Exit::Done;
}

}  // namespace lmc
