# Options; languages, flags and sanitizers of every C and C++ target.
#
# What is built follows from these options alone, never from what this machine has: where an option asks for a tool
# that is missing, configuring fails. `make build` turns all of them on but CRUX_SANITIZE (tools/setup/configure).
option(CRUX_TESTS "Build the C++ tests (needs GoogleTest and nlohmann-json)" OFF)
option(CRUX_FIRMWARE "Build the node images (needs arm-none-eabi-gcc with newlib)" OFF)
option(CRUX_EMULATED "Build the emulated node boards (needs Unicorn, which is under the GPL)" OFF)
option(CRUX_CCACHE "Compile through ccache" OFF)
option(CRUX_SANITIZE "Build with AddressSanitizer and UndefinedBehaviorSanitizer" OFF)

# crux_require(<option> <found> <what> <Debian packages>): ends the configuration where a tool that <option> needs is missing
function(crux_require option found what packages)
  if(NOT found)
    message(FATAL_ERROR "${option}=ON needs ${what}, which is not installed (Debian: apt-get install ${packages}; "
                        "`make setup` installs all that development needs). Or configure with -D${option}=OFF.")
  endif()
endfunction()

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "" FORCE)
endif()
set(lines "")
if(CRUX_TESTS) # nine tenths of what a build takes on disk
  set(lines " -g1")
endif()
foreach(language C CXX)
  set(CMAKE_${language}_FLAGS_RELWITHDEBINFO "-O2${lines} -DNDEBUG")
  set(CMAKE_${language}_FLAGS_DEBUG "-O2 -g1") # lines for the sanitizers' reports; more would take a third longer
endforeach()

set(CMAKE_C_STANDARD 11)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

# No fused multiply-add behind our back: the same inputs give the same bits in runtime, bench and replay.
add_compile_options(-Wall -Wextra -Wpedantic -ffp-contract=off)
if(CRUX_SANITIZE)
  add_compile_options(-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
  # Checks of every reference take Eigen's small functions apart: twice the time to compile, and many times the time to
  # run. What they would find in C++, AddressSanitizer and Eigen's own assertions find as well.
  add_compile_options($<$<COMPILE_LANGUAGE:CXX>:-fno-sanitize=null,alignment,object-size,vptr>)
  add_link_options(-fsanitize=address,undefined)
endif()

# What `cmake --install` lays down runs wherever that folder is moved: programs find libraries in lib/crux beside bin,
# and so do those libraries (the older kind of path, which is theirs, too).
set(CRUX_LIBDIR lib/crux)
set(CMAKE_INSTALL_RPATH $ORIGIN $ORIGIN/../${CRUX_LIBDIR})
add_link_options(LINKER:--disable-new-dtags)

# crux_unite(<target>): without tests or for sanitizers, the sources of each folder are compiled as one: most of the time goes to headers.
function(crux_unite target)
  if(CRUX_TESTS AND NOT CRUX_SANITIZE)
    return()
  endif()
  get_target_property(sources ${target} SOURCES)
  foreach(source ${sources})
    cmake_path(GET source PARENT_PATH folder)
    set_source_files_properties(${source} PROPERTIES UNITY_GROUP "folder_${folder}")
  endforeach()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
endfunction()

if(CRUX_CCACHE)
  find_program(CRUX_CCACHE_PROGRAM ccache)
  crux_require(CRUX_CCACHE "${CRUX_CCACHE_PROGRAM}" ccache ccache)
  # It goes by the headers that the compiler names, and does not run the preprocessor a second time for what it has not;
  # the sloppiness lets it work with the precompiled headers of the tests.
  set(cached ${CMAKE_COMMAND} -E env CCACHE_DEPEND=1 CCACHE_SLOPPINESS=pch_defines,time_macros ${CRUX_CCACHE_PROGRAM})
  set(CMAKE_C_COMPILER_LAUNCHER ${cached})
  set(CMAKE_CXX_COMPILER_LAUNCHER ${cached})
endif()
