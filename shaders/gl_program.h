#pragma once
/// A pass as a GL program, and its uniforms by name. Private to shaders.
#include <glm/glm.hpp>
#include <span>

#include "shaders/gl.h"
#include "shaders/passes.h"

namespace lmc::shaders {

class GlProgram {
 public:
  /// Compiles and links. Throws Error Broken that names file and line.
  GlProgram(const GlContext&, const PassRow&, const std::filesystem::path& folder);
  void use() const { gl_.UseProgram(program_); }

  // Uniforms that the shader does not use are left alone.
  void set(const char* name, int value) const { gl_.Uniform1i(at(name), value); }
  void set(const char* name, double value) const { gl_.Uniform1f(at(name), float(value)); }
  void set(const char* name, const glm::dvec2& v) const { gl_.Uniform2f(at(name), float(v.x), float(v.y)); }
  void set(const char* name, const glm::dvec3& v) const { gl_.Uniform3f(at(name), float(v.x), float(v.y), float(v.z)); }
  void set(const char* name, const glm::dvec4& v) const { gl_.Uniform4f(at(name), float(v.x), float(v.y), float(v.z), float(v.w)); }
  void set(const char* name, const glm::dmat3& m) const {
    const glm::mat3 f(m);
    gl_.UniformMatrix3fv(at(name), 1, GL_FALSE, &f[0][0]);
  }
  void set(const char* name, const glm::dmat4& m) const {
    const glm::mat4 f(m);
    gl_.UniformMatrix4fv(at(name), 1, GL_FALSE, &f[0][0]);
  }
  void set(const char* name, std::span<const int> v) const { gl_.Uniform1iv(at(name), GLsizei(v.size()), v.data()); }
  void set(const char* name, std::span<const glm::mat3> m) const {
    gl_.UniformMatrix3fv(at(name), GLsizei(m.size()), GL_FALSE, &m[0][0][0]);
  }

 private:
  GLint at(const char* name) const { return gl_.GetUniformLocation(program_, name); }
  const GlContext& gl_;
  GLuint program_ = 0;
};

}  // namespace lmc::shaders
