#!/usr/bin/env python3
"""Who may know whom: reads every #include and fails on an arrow that docs/stages.md does not draw, or on a second door to an outside library."""
import pathlib, re, sys

root = pathlib.Path(sys.argv[1])
FOLDERS = {  # folder -> project folders that it may include
    'libscene': {'libscene'},
    'libradiosity': {'libscene', 'libradiosity'},
    'libao': {'libscene', 'libao'},
    'libtangent': {'libtangent'},
    'shaders': {'libscene', 'shaders'},
    'lmc': {'libscene', 'libradiosity', 'libao', 'libtangent', 'shaders', 'lmc'},
}
DOORS = {  # outside header -> files that may include it
    r'embree3/': {'libscene/tracer.cpp'},
    r'CGAL/': {'libscene/charts.cpp', 'libscene/flatten.cpp'},
    r'OpenMesh/': {'libradiosity/patch_mesh.cpp'},
    r'Imf|half\.h|Imath': {'libscene/exr.cpp'},
    r'png\.h|jpeglib\.h': {'libscene/image_file.cpp'},
    r'tbb/': {'libscene/parallel.h'},
    r'CLI/': {'lmc/options.cpp'},
    r'xxhash\.h': {'libscene/files.cpp'},
    r'ceres/': {'libradiosity/seam_solve.cpp', 'lmc/fits.cpp'},
    r'Eigen/': {'libradiosity/solve.cpp'},
    r'GL/': {'shaders/gl.h', 'shaders/gl.cpp'},
    r'dlfcn\.h': {'shaders/gl.cpp'},
    r'tiny_gltf\.h': {'libscene/gltf_read.h', 'libscene/gltf_read.cpp'},
}
TEST_DOORS = {  # the same for tests: an oracle of its own each
    r'CGAL/': {'tests/libscene/exact_rays_stability_test.cpp'},
    r'embree3/|OpenMesh/|CLI/|GL/': set(),
}
bad = []
count = 0
for path in sorted(root.glob('tests/**/*.[ch]*')):
    for number, text in enumerate(path.read_text().splitlines(), 1):
        m = re.match(r'\s*#\s*include\s*[<"]([^>"]+)[>"]', text)
        for door, files in TEST_DOORS.items():
            if m and re.match(door, m.group(1)) and str(path.relative_to(root)) not in files:
                bad.append(f'{path.relative_to(root)}:{number}: no test but {", ".join(sorted(files)) or "none"} may include {m.group(1)}')
for folder, allowed in FOLDERS.items():
    for path in sorted(root.glob(f'{folder}/**/*')):
        if path.suffix not in ('.h', '.cpp'):
            continue
        name = str(path.relative_to(root))
        for number, text in enumerate(path.read_text().splitlines(), 1):
            m = re.match(r'\s*#\s*include\s*[<"]([^>"]+)[>"]', text)
            if not m:
                continue
            count += 1
            target = m.group(1)
            if target.split('/')[0] in FOLDERS and target.split('/')[0] not in allowed:
                bad.append(f'{name}:{number}: {folder} must not know {target}')
            for door, files in DOORS.items():
                if re.match(door, target) and name not in files:
                    bad.append(f'{name}:{number}: {target} has its door in {", ".join(sorted(files))}')
print('\n'.join(bad) or f'{count} includes, no arrow out of place')
sys.exit(1 if bad or count < 100 else 0)
