#pragma once
/// The door to OSMesa: a GL 3.3 core context without a display, opened at run time. Private to shaders.
#include <GL/glcorearb.h>

#include <memory>

#include "libscene/float_traps.h"

namespace lmc::shaders {

#define LMC_GL_FUNCTIONS(X)                                                                                                               \
  X(ActiveTexture, ACTIVETEXTURE)                                                                                                         \
  X(AttachShader, ATTACHSHADER)                                                                                                           \
  X(BindBuffer, BINDBUFFER)                                                                                                               \
  X(BindFramebuffer, BINDFRAMEBUFFER)                                                                                                     \
  X(BindSampler, BINDSAMPLER)                                                                                                             \
  X(BindTexture, BINDTEXTURE)                                                                                                             \
  X(BindVertexArray, BINDVERTEXARRAY) X(BlendFunc, BLENDFUNC) X(BufferData, BUFFERDATA) X(CheckFramebufferStatus, CHECKFRAMEBUFFERSTATUS) \
      X(ClearBufferfv, CLEARBUFFERFV) X(CompileShader, COMPILESHADER) X(CreateProgram, CREATEPROGRAM) X(CreateShader, CREATESHADER)       \
          X(CullFace, CULLFACE) X(DeleteFramebuffers, DELETEFRAMEBUFFERS) X(DeleteShader, DELETESHADER) X(DeleteTextures, DELETETEXTURES) \
              X(DepthFunc, DEPTHFUNC) X(DepthMask, DEPTHMASK) X(Disable, DISABLE) X(DrawArrays, DRAWARRAYS) X(DrawBuffers, DRAWBUFFERS)   \
                  X(DrawElements, DRAWELEMENTS) X(Enable, ENABLE) X(EnableVertexAttribArray, ENABLEVERTEXATTRIBARRAY)                     \
                      X(FramebufferTexture2D, FRAMEBUFFERTEXTURE2D) X(GenBuffers, GENBUFFERS) X(GenFramebuffers, GENFRAMEBUFFERS)         \
                          X(GenSamplers, GENSAMPLERS) X(GenTextures, GENTEXTURES) X(GenVertexArrays, GENVERTEXARRAYS)                     \
                              X(GetError, GETERROR) X(GetIntegerv, GETINTEGERV) X(GetProgramInfoLog, GETPROGRAMINFOLOG)                   \
                                  X(GetProgramiv, GETPROGRAMIV) X(GetShaderInfoLog, GETSHADERINFOLOG) X(GetShaderiv, GETSHADERIV)         \
                                      X(GetUniformLocation, GETUNIFORMLOCATION) X(LinkProgram, LINKPROGRAM) X(PixelStorei, PIXELSTOREI)   \
                                          X(ReadBuffer, READBUFFER) X(ReadPixels, READPIXELS) X(SamplerParameteri, SAMPLERPARAMETERI)     \
                                              X(ShaderSource, SHADERSOURCE) X(TexImage2D, TEXIMAGE2D) X(TexParameteri, TEXPARAMETERI)     \
                                                  X(Uniform1f, UNIFORM1F) X(Uniform1i, UNIFORM1I) X(Uniform1iv, UNIFORM1IV)               \
                                                      X(Uniform2f, UNIFORM2F) X(Uniform3f, UNIFORM3F) X(Uniform4f, UNIFORM4F)             \
                                                          X(UniformMatrix3fv, UNIFORMMATRIX3FV) X(UniformMatrix4fv, UNIFORMMATRIX4FV)     \
                                                              X(UseProgram, USEPROGRAM) X(VertexAttribPointer, VERTEXATTRIBPOINTER)       \
                                                                  X(Viewport, VIEWPORT)

/// Functions of GL by their names without "gl".
struct GlFunctions {
#define LMC_GL_MEMBER(name, NAME) PFNGL##NAME##PROC name = nullptr;
  LMC_GL_FUNCTIONS(LMC_GL_MEMBER)
#undef LMC_GL_MEMBER
};

/// One context, current on the thread that made it. The library is libOSMesa.so.8, or what the environment's LMC_OSMESA names.
class GlContext : public GlFunctions {
 public:
  /// Throws Error Unsupported that names what is missing.
  GlContext();
  ~GlContext();
  GlContext(const GlContext&) = delete;
  GlContext& operator=(const GlContext&) = delete;

  /// Throws Error Limit or Internal when GL has met an error since the last call.
  void check(const char* doing) const;

 private:
  NoFloatTraps whileItLives_;  // first, so that it outlasts the library: GL starts threads of its own
  struct Library;
  std::unique_ptr<Library> library_;
};

}  // namespace lmc::shaders
