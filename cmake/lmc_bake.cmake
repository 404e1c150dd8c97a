# lmc_bake(TARGET name LEVEL level.glb OUTPUT_DIR folder [ALL] [ARGS option...])
#
# A target that keeps the light maps of a level up to date: it bakes when the level, a buffer or a picture that the level
# names, the program or the options change, and only then. ALL makes it part of the default build. Under Ninja bakes run one
# after the other, for each of them uses all threads.
#   LEVEL       relative to the current source folder
#   OUTPUT_DIR  relative to the current binary folder; level.lmc.json in it stands for the whole set (it is written last)
#   ARGS        passed to `lmc bake`, such as --preset final
# The target's property LMC_OUTPUT_DIR holds the full path of the folder.
# Works with the generators Ninja and Unix Makefiles of CMake 3.20 or later.
include_guard(GLOBAL)

cmake_policy(PUSH)
cmake_policy(VERSION 3.20)   # CMP0116 NEW: full paths in a depfile are understood whichever generator reads it

function(lmc_bake)
  cmake_parse_arguments(PARSE_ARGV 0 arg "ALL" "TARGET;LEVEL;OUTPUT_DIR" "ARGS")
  foreach(needed TARGET LEVEL OUTPUT_DIR)
    if(NOT arg_${needed})
      message(FATAL_ERROR "lmc_bake: ${needed} is missing")
    endif()
  endforeach()
  if(arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "lmc_bake: unknown arguments: ${arg_UNPARSED_ARGUMENTS}")
  endif()

  cmake_path(ABSOLUTE_PATH arg_LEVEL BASE_DIRECTORY "${CMAKE_CURRENT_SOURCE_DIR}" NORMALIZE OUTPUT_VARIABLE level)
  cmake_path(ABSOLUTE_PATH arg_OUTPUT_DIR BASE_DIRECTORY "${CMAKE_CURRENT_BINARY_DIR}" NORMALIZE OUTPUT_VARIABLE out)
  set(depfile "${CMAKE_CURRENT_BINARY_DIR}/${arg_TARGET}.lmc.d")

  set(pool "")
  if(CMAKE_GENERATOR MATCHES "Ninja")
    get_property(pools GLOBAL PROPERTY JOB_POOLS)
    if(NOT "lmc_bake=1" IN_LIST pools)
      set_property(GLOBAL APPEND PROPERTY JOB_POOLS lmc_bake=1)
    endif()
    set(pool JOB_POOL lmc_bake)
  endif()

  add_custom_command(
    OUTPUT "${out}/level.lmc.json"
    BYPRODUCTS "${out}/lightmap.exr" "${out}/level.glb" "${out}/report.json"
    COMMAND lmc::lmc bake "${level}" -o "${out}" --depfile "${depfile}" --progress lines ${arg_ARGS}
    DEPENDS "${level}" "$<TARGET_FILE:lmc::lmc>"
    DEPFILE "${depfile}"
    COMMENT "Baking light maps of ${arg_LEVEL}"
    ${pool}
    VERBATIM)

  set(all "")
  if(arg_ALL)
    set(all ALL)
  endif()
  add_custom_target(${arg_TARGET} ${all} DEPENDS "${out}/level.lmc.json")
  set_target_properties(${arg_TARGET} PROPERTIES LMC_OUTPUT_DIR "${out}")
endfunction()

cmake_policy(POP)
