# Writes the GLSL files as C++: cmake -DOUT=embedded.cpp -DROOT=shaders -DNAMES=a.frag,b.glsl -P embed.cmake
string(REPLACE "," ";" names "${NAMES}")
set(text "#include \"shaders/embedded.h\"\n\nnamespace lmc::shaders {\n\nstatic const EmbeddedShader kAll[] = {\n")
foreach(name ${names})
  file(READ ${ROOT}/${name} body)
  string(APPEND text "    {\"${name}\", R\"glsl(${body})glsl\"},\n")
endforeach()
string(APPEND text "};\nconst std::span<const EmbeddedShader> kEmbeddedShaders(kAll);\n\n}  // namespace lmc::shaders\n")
file(WRITE ${OUT} "${text}")
