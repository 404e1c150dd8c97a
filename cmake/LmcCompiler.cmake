# One language standard, one set of warnings and the flags that keep numbers the same on every run.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)

find_program(LMC_CCACHE ccache)
if(LMC_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_C_COMPILER_LAUNCHER ${LMC_CCACHE})
  set(CMAKE_CXX_COMPILER_LAUNCHER ${LMC_CCACHE})
endif()

add_library(lmc_warnings INTERFACE)
# A fused multiply-add rounds once where two operations round twice: with it the bytes of a map would depend on the compiler's mood.
# GCC 12 divides two neighbouring floats as a vector of four whose other half is what happened to lie there: a zero by a zero of leftovers
# ends a program whose floats trap (libscene/float_traps.h). A target with the property LMC_IDLE_LANES may do so.
target_compile_options(lmc_warnings INTERFACE -Wall -Wextra -Wshadow -Wnon-virtual-dtor -ffp-contract=off
                                              $<$<NOT:$<BOOL:$<TARGET_PROPERTY:LMC_IDLE_LANES>>>:-fno-tree-slp-vectorize>
                                              $<$<BOOL:${LMC_WERROR}>:-Werror>)
target_include_directories(lmc_warnings INTERFACE ${PROJECT_SOURCE_DIR})
target_compile_definitions(lmc_warnings INTERFACE GLM_ENABLE_EXPERIMENTAL GLM_FORCE_EXPLICIT_CTOR)

if(LMC_SANITIZE)
  add_compile_options(-fsanitize=${LMC_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=undefined)
  add_link_options(-fsanitize=${LMC_SANITIZE})
endif()

if(LMC_FUZZ)
  add_compile_options(-fsanitize=fuzzer-no-link)
endif()

# lmc_library(NAME SOURCES...): a static library per folder.
function(lmc_library name)
  add_library(${name} STATIC ${ARGN})
  add_library(lmc::${name} ALIAS ${name})
  set_target_properties(${name} PROPERTIES OUTPUT_NAME lmc_${name})
  target_link_libraries(${name} PRIVATE $<BUILD_INTERFACE:lmc_warnings>)   # flags of this build, not of those who use the library
  target_include_directories(${name} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/lmc>)
endfunction()
