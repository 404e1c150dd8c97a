#include "shaders/gl.h"

#include <GL/osmesa.h>
#include <dlfcn.h>
#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <memory>

#include "libscene/error.h"

#ifdef __SANITIZE_ADDRESS__
/// Mesa keeps some hundred bytes a context.
extern "C" const char* __lsan_default_suppressions() { return "leak:libOSMesa"; }
#endif

namespace lmc::shaders {

namespace {

constexpr const char* kLibrary = "libOSMesa.so.8";  // its major version is part of the name; Debian's package is libosmesa6
constexpr int kSide = 4;                            // of the window that a context must have; pictures go to framebuffers of their own

Error missing(const std::string& what) {
  return Error(Exit::Unsupported, "shaders", "",
               what +
                   "; pictures need OSMesa with GL 3.3 (Debian: apt-get install libosmesa6), everything else works without; "
                   "--oracle draws without it",
               "LMC_OSMESA");
}

}  // namespace

struct GlContext::Library {
  void* handle = nullptr;
  OSMesaContext context = nullptr;
  std::array<std::uint8_t, std::size_t(kSide) * kSide * 4> window{};
  decltype(&OSMesaCreateContextAttribs) create = nullptr;
  decltype(&OSMesaMakeCurrent) makeCurrent = nullptr;
  decltype(&OSMesaDestroyContext) destroy = nullptr;
  decltype(&OSMesaGetProcAddress) address = nullptr;

  ~Library() {
    if (context) destroy(context);
    // The handle stays open: Mesa has threads and exit handlers of its own, which must not lose their code.
  }
  template <class F>
  void find(F& function, const char* name) {
    function = reinterpret_cast<F>(dlsym(handle, name));
    if (!function) throw missing(fmt::format("the OSMesa library has no {}", name));
  }
};

GlContext::GlContext() {
  auto library = std::make_unique<Library>();
  const char* named = std::getenv("LMC_OSMESA");
  const char* file = named && *named ? named : kLibrary;
  library->handle = dlopen(file, RTLD_NOW | RTLD_LOCAL);
  if (!library->handle) throw missing(fmt::format("the library {} cannot be opened ({})", file, dlerror()));
  library->find(library->create, "OSMesaCreateContextAttribs");
  library->find(library->makeCurrent, "OSMesaMakeCurrent");
  library->find(library->destroy, "OSMesaDestroyContext");
  library->find(library->address, "OSMesaGetProcAddress");
  const int wanted[] = {
      OSMESA_FORMAT, OSMESA_RGBA, OSMESA_PROFILE, OSMESA_CORE_PROFILE, OSMESA_CONTEXT_MAJOR_VERSION, 3, OSMESA_CONTEXT_MINOR_VERSION, 3, 0};
  library->context = library->create(wanted, nullptr);
  if (!library->context || !library->makeCurrent(library->context, library->window.data(), GL_UNSIGNED_BYTE, kSide, kSide))
    throw missing(fmt::format("the library {} gives no GL 3.3 core context", file));
#define LMC_GL_LOAD(name, NAME)                                                   \
  this->name = reinterpret_cast<PFNGL##NAME##PROC>(library->address("gl" #name)); \
  if (!this->name) throw missing("the OSMesa library has no gl" #name);
  LMC_GL_FUNCTIONS(LMC_GL_LOAD)
#undef LMC_GL_LOAD
  library_ = std::move(library);
}

GlContext::~GlContext() = default;

void GlContext::check(const char* doing) const {
  const GLenum error = GetError();
  if (error == GL_NO_ERROR) return;
  if (error == GL_OUT_OF_MEMORY)
    throw Error(Exit::Limit, "shaders", "", fmt::format("GL has no memory left while {}", doing), "LMC_MEMORY");
  throw Error(Exit::Internal, "shaders", "", fmt::format("GL error {:#x} while {}", error, doing), "LMC_GL");
}

}  // namespace lmc::shaders
