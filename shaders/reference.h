#pragma once
/// The reference shader: the GLSL passes of deferred/, run without a display.
#include <array>
#include <filesystem>
#include <memory>

#include "shaders/passes.h"
#include "shaders/view.h"

namespace lmc::shaders {

/// Which passes are drawn by the user's files.
struct ShaderChoice {
  std::filesystem::path folder;            ///< empty: there are none
  std::array<bool, kPasses.size()> own{};  ///< by Pass: take what the folder has of it
  static ShaderChoice all(const std::filesystem::path& folder) {
    ShaderChoice out{folder, {}};
    out.own.fill(!folder.empty());
    return out;
  }
};

/// A level on the (software) GPU. One thread; the same bytes every time.
class Reference {
 public:
  /// Both stay where they are while this lives. Throws Error Unsupported where there is no OSMesa.
  Reference(const ShadingLevel&, const LevelMaps&);
  ~Reference();
  Reference(const Reference&) = delete;
  Reference& operator=(const Reference&) = delete;

  /// Throws Error Broken, with the compiler's words, for a shader that does not compile.
  Frame render(const View&, const ShaderChoice& = {});

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace lmc::shaders
