#include "shaders/gl_program.h"

#include <fmt/format.h>

#include "libscene/error.h"

namespace lmc::shaders {

namespace {

/// On one line.
std::string joined(std::string text) {
  while (text.ends_with('\n')) text.pop_back();
  for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.replace(at, 1, "; ");
  return text;
}

/// The compiler's first complaint becomes the place of the error, the rest its text.
Error compileError(const std::string& log, const ShaderText& shader) {
  const std::size_t end = log.find('\n');
  const std::string first = log.substr(0, end), rest = end == std::string::npos ? std::string() : log.substr(end + 1);
  for (const auto& file : shader.files) {
    const std::string prefix = file.string() + ":";
    if (!first.starts_with(prefix)) continue;
    const std::size_t colon = first.find(": ", prefix.size());
    const std::string place = first.substr(prefix.size(), colon - prefix.size());
    std::string text = colon == std::string::npos ? "does not compile" : first.substr(colon + 2);
    if (text.starts_with("error: ")) text.erase(0, 7);
    return Error(Exit::Broken, file, place, rest.empty() ? text : joined(text + "\n" + rest), "LMC_SHADER");
  }
  return Error(Exit::Broken, shader.files.front(), "", log.empty() ? "does not compile" : joined(log), "LMC_SHADER");
}

GLuint compiled(const GlContext& gl, GLenum stage, const ShaderText& shader) {
  const GLuint out = gl.CreateShader(stage);
  const char* text = shader.text.c_str();
  gl.ShaderSource(out, 1, &text, nullptr);
  gl.CompileShader(out);
  GLint good = 0, length = 0;
  gl.GetShaderiv(out, GL_COMPILE_STATUS, &good);
  if (good) return out;
  gl.GetShaderiv(out, GL_INFO_LOG_LENGTH, &length);
  std::string log(std::size_t(length) + 1, '\0');
  gl.GetShaderInfoLog(out, length, nullptr, log.data());
  throw compileError(namedLog(log.c_str(), shader), shader);
}

}  // namespace

GlProgram::GlProgram(const GlContext& gl, const PassRow& pass, const std::filesystem::path& folder) : gl_(gl) {
  const ShaderText vertexText = shaderText(pass.vertex, folder), fragmentText = shaderText(pass.fragment, folder);
  program_ = gl.CreateProgram();
  const GLuint vertex = compiled(gl, GL_VERTEX_SHADER, vertexText), fragment = compiled(gl, GL_FRAGMENT_SHADER, fragmentText);
  gl.AttachShader(program_, vertex);
  gl.AttachShader(program_, fragment);
  gl.LinkProgram(program_);
  gl.DeleteShader(vertex);
  gl.DeleteShader(fragment);
  GLint good = 0, length = 0;
  gl.GetProgramiv(program_, GL_LINK_STATUS, &good);
  if (good) return;
  gl.GetProgramiv(program_, GL_INFO_LOG_LENGTH, &length);
  std::string log(std::size_t(length) + 1, '\0');
  gl.GetProgramInfoLog(program_, length, nullptr, log.data());
  throw Error(Exit::Broken, fragmentText.files.front(), "",
              fmt::format("does not link with {}: {}", vertexText.files.front().string(), joined(log.c_str())), "LMC_SHADER");
}

}  // namespace lmc::shaders
