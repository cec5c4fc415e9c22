//! Embree's shared library, found and loaded at run time, and the part of its C
//! interface (version 4) that is used here. The only unsafe code of the systems.
//!
//! Names, values and layouts are those of Embree 4's public headers.

use std::env;
use std::error::Error;
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicIsize, Ordering};

use libloading::Library;

use crate::rays::{LANES, RayBlock};

/// The environment variable that names the library's file.
pub(super) const VARIABLE: &str = "SPLITCAST_EMBREE";

/// The major version whose interface is spoken.
const VERSION: isize = 4;

type Handle = *mut c_void;

/// Where systems keep the library, as far as the loader does not know itself.
const PLACES: [&str; 4] = [
    "/usr/local/lib/libembree4.so.4",
    "/usr/local/lib64/libembree4.so.4",
    "/opt/homebrew/lib/libembree4.dylib",
    "/usr/local/lib/libembree4.dylib",
];

/// Names that the loader looks for in its own places.
const NAMES: [&str; 5] = [
    "libembree4.so.4",
    "libembree4.so",
    "libembree4.4.dylib",
    "libembree4.dylib",
    "embree4.dll",
];

const DEVICE_PROPERTY_VERSION_MAJOR: c_int = 1;
const DEVICE_PROPERTY_VERSION_MINOR: c_int = 2;
const DEVICE_PROPERTY_VERSION_PATCH: c_int = 3;
const GEOMETRY_TYPE_TRIANGLE: c_int = 0;
const BUFFER_TYPE_INDEX: c_int = 0;
const BUFFER_TYPE_VERTEX: c_int = 1;
const FORMAT_UINT3: c_int = 0x5003;
const FORMAT_FLOAT3: c_int = 0x9003;
const FLAG_INCOHERENT: c_int = 0;
const FLAG_COHERENT: c_int = 1 << 16;
const FEATURES_ALL: c_uint = u32::MAX;
/// The number of no geometry.
const INVALID: u32 = u32::MAX;

/// How much work goes into a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub(super) enum BuildQuality {
    Low = 0,
    Medium = 1,
    High = 2,
    Refit = 3,
}

/// Flags of a scene.
#[derive(Clone, Copy, Debug)]
#[repr(i32)]
pub(super) enum SceneFlags {
    Static = 0,
    Dynamic = 1,
}

/// How rays of a call relate to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coherence {
    Incoherent,
    Coherent,
}

/// Arguments of a query. The last field is only known to some builds of the library.
#[repr(C)]
struct QueryArguments {
    flags: c_int,
    features: c_uint,
    context: *mut c_void,
    filter: Option<unsafe extern "C" fn(*const c_void)>,
    intersect: Option<unsafe extern "C" fn(*const c_void)>,
    min_width_distance_factor: f32,
}

impl QueryArguments {
    fn new(coherence: Coherence) -> Self {
        Self {
            flags: match coherence {
                Coherence::Incoherent => FLAG_INCOHERENT,
                Coherence::Coherent => FLAG_COHERENT,
            },
            features: FEATURES_ALL,
            context: ptr::null_mut(),
            filter: None,
            intersect: None,
            min_width_distance_factor: 0.0,
        }
    }
}

/// Widest alignment that the library asks for: that of packets of 16.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Aligned<T>(pub(super) T);

/// `N` rays, lane by lane. Passed on its own only in [`Aligned`].
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Rays<const N: usize> {
    origin: [[f32; N]; 3],
    t_near: [f32; N],
    direction: [[f32; N]; 3],
    time: [f32; N],
    pub(super) t_far: [f32; N],
    mask: [u32; N],
    id: [u32; N],
    flags: [u32; N],
}

/// `N` rays and what they hit. Older versions know one instance number less;
/// it is the last field, so that they leave it alone.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct RayHits<const N: usize> {
    pub(super) rays: Rays<N>,
    normal: [[f32; N]; 3],
    u: [f32; N],
    v: [f32; N],
    pub(super) triangle: [u32; N],
    pub(super) geometry: [u32; N],
    instance: [u32; N],
    instance_primitive: [u32; N],
}

impl<const N: usize> Rays<N> {
    /// Lanes `first..first + N` of a block.
    #[inline(always)]
    pub(super) fn of_block(block: &RayBlock, first: usize) -> Self {
        let lanes = |values: &[f32; LANES]| -> [f32; N] {
            values[first..first + N]
                .try_into()
                .expect("a packet is a part of a block")
        };
        let vectors = |v: &[[f32; LANES]; 3]| [lanes(&v[0]), lanes(&v[1]), lanes(&v[2])];
        Self {
            origin: vectors(&block.origin),
            t_near: lanes(&block.t_min),
            direction: vectors(&block.direction),
            time: [0.0; N],
            t_far: lanes(&block.t_max),
            mask: [u32::MAX; N],
            id: [0; N],
            flags: [0; N],
        }
    }

    /// Which lanes hold a ray, as the library wants to know it.
    #[inline(always)]
    fn valid(&self) -> Aligned<[c_int; N]> {
        let mut valid = Aligned([0; N]);
        for lane in 0..N {
            valid.0[lane] = if self.t_near[lane] <= self.t_far[lane] {
                -1
            } else {
                0
            };
        }
        valid
    }
}

impl Rays<1> {
    /// One ray.
    #[inline(always)]
    pub(super) fn of_ray(ray: &splitcast::Ray) -> Self {
        let vector = |v: [f32; 3]| [[v[0]], [v[1]], [v[2]]];
        Self {
            origin: vector(ray.origin),
            t_near: [ray.t_min],
            direction: vector(ray.direction),
            time: [0.0],
            t_far: [ray.t_max],
            mask: [u32::MAX],
            id: [0],
            flags: [0],
        }
    }
}

impl<const N: usize> RayHits<N> {
    /// Rays that hit nothing yet.
    #[inline(always)]
    pub(super) fn new(rays: Rays<N>) -> Self {
        Self {
            rays,
            normal: [[0.0; N]; 3],
            u: [0.0; N],
            v: [0.0; N],
            triangle: [INVALID; N],
            geometry: [INVALID; N],
            instance: [INVALID; N],
            instance_primitive: [INVALID; N],
        }
    }

    /// Distance and triangle of what a lane hit.
    #[inline(always)]
    pub(super) fn hit(&self, lane: usize) -> (f32, u32) {
        let t = if self.geometry[lane] == INVALID {
            f32::INFINITY
        } else {
            self.rays.t_far[lane]
        };
        (t, self.triangle[lane])
    }
}

/// Declares the functions that are used, and how they are looked up.
macro_rules! functions {
    ($($name:ident: $symbol:literal ($($argument:ty),*) $(-> $result:ty)?;)*) => {
        struct Functions {
            $($name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            /// # Safety
            /// The library has to be Embree 4, whose functions have these types.
            unsafe fn find(library: &Library) -> Result<Self, libloading::Error> {
                Ok(Self {
                    // SAFETY: as promised by the caller.
                    $($name: *unsafe { library.get($symbol) }?,)*
                })
            }
        }
    };
}

functions! {
    new_device: b"rtcNewDevice\0" (*const c_char) -> Handle;
    release_device: b"rtcReleaseDevice\0" (Handle);
    device_error: b"rtcGetDeviceError\0" (Handle) -> c_int;
    device_property: b"rtcGetDeviceProperty\0" (Handle, c_int) -> isize;
    set_memory_monitor: b"rtcSetDeviceMemoryMonitorFunction\0"
        (Handle, Option<unsafe extern "C" fn(*mut c_void, isize, bool) -> bool>, *mut c_void);
    new_scene: b"rtcNewScene\0" (Handle) -> Handle;
    release_scene: b"rtcReleaseScene\0" (Handle);
    set_scene_quality: b"rtcSetSceneBuildQuality\0" (Handle, c_int);
    set_scene_flags: b"rtcSetSceneFlags\0" (Handle, c_int);
    commit_scene: b"rtcCommitScene\0" (Handle);
    new_geometry: b"rtcNewGeometry\0" (Handle, c_int) -> Handle;
    release_geometry: b"rtcReleaseGeometry\0" (Handle);
    set_geometry_quality: b"rtcSetGeometryBuildQuality\0" (Handle, c_int);
    set_shared_buffer: b"rtcSetSharedGeometryBuffer\0"
        (Handle, c_int, c_uint, c_int, *const c_void, usize, usize, usize);
    commit_geometry: b"rtcCommitGeometry\0" (Handle);
    attach_geometry: b"rtcAttachGeometry\0" (Handle, Handle) -> c_uint;
    intersect_1: b"rtcIntersect1\0" (Handle, *mut RayHits<1>, *const QueryArguments);
    intersect_8: b"rtcIntersect8\0"
        (*const Aligned<[c_int; 8]>, Handle, *mut RayHits<8>, *const QueryArguments);
    intersect_16: b"rtcIntersect16\0"
        (*const Aligned<[c_int; 16]>, Handle, *mut RayHits<16>, *const QueryArguments);
    occluded_1: b"rtcOccluded1\0" (Handle, *mut Aligned<Rays<1>>, *const QueryArguments);
    occluded_8: b"rtcOccluded8\0"
        (*const Aligned<[c_int; 8]>, Handle, *mut Aligned<Rays<8>>, *const QueryArguments);
    occluded_16: b"rtcOccluded16\0"
        (*const Aligned<[c_int; 16]>, Handle, *mut Aligned<Rays<16>>, *const QueryArguments);
}

/// The loaded library.
pub(super) struct Embree {
    functions: Functions,
    /// Never unloaded: threads of its own and of ours may still hold on to its code.
    _library: ManuallyDrop<Library>,
}

impl Embree {
    /// Loads the library: the file that [`VARIABLE`] names, or the first that is found. Gives its
    /// version, too.
    pub(super) fn load() -> Result<(Arc<Self>, String), String> {
        if let Some(path) = env::var_os(VARIABLE) {
            let path = PathBuf::from(path);
            let embree = Self::open(&path).map_err(|error| {
                // The reason lies behind the error's own words.
                let reason = error
                    .source()
                    .map_or(error.to_string(), ToString::to_string);
                format!("{VARIABLE}={}: {reason}", path.display())
            });
            return Self::with_version(embree?);
        }
        let candidates = NAMES.iter().chain(&PLACES).map(PathBuf::from);
        match candidates.filter_map(|path| Self::open(&path).ok()).next() {
            Some(embree) => Self::with_version(embree),
            None => Err("no library was found in the usual places".to_owned()),
        }
    }

    fn open(path: &Path) -> Result<Arc<Self>, libloading::Error> {
        // SAFETY: a file that is named as Embree's, or by the user, is Embree. Loading it runs
        // its initialisation, as starting any program that is linked to it would.
        let library = unsafe { Library::new(path) }?;
        // SAFETY: the names are those of version 4. Another version that has all of them is
        // found out by its number before anything else than a device is made, which all
        // versions make alike.
        let functions = unsafe { Functions::find(&library) }?;
        Ok(Arc::new(Self {
            functions,
            _library: ManuallyDrop::new(library),
        }))
    }

    fn with_version(embree: Arc<Self>) -> Result<(Arc<Self>, String), String> {
        let version = Device::new(&embree, 1)?.version();
        if version[0] != VERSION {
            let found = version[0];
            return Err(format!(
                "version {found} was found, but version {VERSION} is needed"
            ));
        }
        let version = version.map(|part| part.to_string());
        Ok((embree, version.join(".")))
    }
}

/// A device: the library with its threads and its memory.
pub(super) struct Device {
    embree: Arc<Embree>,
    handle: Handle,
    /// What the library holds; it is told about by the memory monitor.
    bytes: Box<AtomicIsize>,
}

// SAFETY: the library's objects may be used from any thread.
unsafe impl Send for Device {}
// SAFETY: as above; only queries, which are thread-safe, take a shared reference.
unsafe impl Sync for Device {}

impl Device {
    /// A device with so many threads, the one that commits included.
    pub(super) fn new(embree: &Arc<Embree>, threads: usize) -> Result<Self, String> {
        let configuration = CString::new(format!("threads={threads}"))
            .expect("the configuration has no zero in it");
        // SAFETY: the text ends in zero and is read only during the call.
        let handle = unsafe { (embree.functions.new_device)(configuration.as_ptr()) };
        let device = Self {
            embree: Arc::clone(embree),
            handle,
            bytes: Box::new(AtomicIsize::new(0)),
        };
        if handle.is_null() {
            return Err("Embree could not make a device".to_owned());
        }
        let bytes: *const AtomicIsize = &*device.bytes;
        // SAFETY: the counter lives in a box of its own until the device is released.
        unsafe {
            (embree.functions.set_memory_monitor)(handle, Some(count_bytes), bytes as *mut c_void);
        }
        device.check()?;
        Ok(device)
    }

    /// Major version, minor version and patch.
    fn version(&self) -> [isize; 3] {
        [
            DEVICE_PROPERTY_VERSION_MAJOR,
            DEVICE_PROPERTY_VERSION_MINOR,
            DEVICE_PROPERTY_VERSION_PATCH,
        ]
        // SAFETY: the device is alive and the properties exist in all versions.
        .map(|property| unsafe { (self.embree.functions.device_property)(self.handle, property) })
    }

    /// Bytes that the library holds for this device.
    pub(super) fn bytes(&self) -> usize {
        self.bytes.load(Ordering::Relaxed).max(0) as usize
    }

    /// The error of the last calls, if there was one.
    fn check(&self) -> Result<(), String> {
        // SAFETY: the device is alive.
        match unsafe { (self.embree.functions.device_error)(self.handle) } {
            0 => Ok(()),
            code => Err(format!("Embree reports error {code}")),
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        if !self.handle.is_null() {
            // SAFETY: the device is alive, and every scene holds a reference of its own to it.
            unsafe { (self.embree.functions.release_device)(self.handle) };
        }
    }
}

/// Called by the library before or after it allocates (`bytes` above 0) or frees.
///
/// # Safety
/// `counter` has to be the counter that the device was given.
unsafe extern "C" fn count_bytes(counter: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: it is the counter that lives as long as the device.
    let counter = unsafe { &*counter.cast_const().cast::<AtomicIsize>() };
    counter.fetch_add(bytes, Ordering::Relaxed);
    true
}

/// A scene of one triangle mesh.
pub(super) struct Scene {
    device: Device,
    scene: Handle,
    geometry: Handle,
    /// Copied once for each topology: the library goes on reading them.
    triangles: Vec<[u32; 3]>,
}

// SAFETY: as for the device.
unsafe impl Send for Scene {}
// SAFETY: as for the device.
unsafe impl Sync for Scene {}

impl Scene {
    /// An empty scene.
    pub(super) fn new(
        device: Device,
        scene_quality: BuildQuality,
        geometry_quality: BuildQuality,
        flags: SceneFlags,
    ) -> Result<Self, String> {
        let functions = &device.embree.functions;
        // SAFETY: the device is alive, and the type is one of the header's.
        let (scene, geometry) = unsafe {
            (
                (functions.new_scene)(device.handle),
                (functions.new_geometry)(device.handle, GEOMETRY_TYPE_TRIANGLE),
            )
        };
        // From here on whatever was made is released, also if something else failed.
        let made = Self {
            device,
            scene,
            geometry,
            triangles: Vec::new(),
        };
        made.device.check()?;
        if scene.is_null() || geometry.is_null() {
            return Err("Embree could not make a scene".to_owned());
        }
        let functions = &made.device.embree.functions;
        // SAFETY: both are alive, and values are those of the headers.
        unsafe {
            (functions.set_scene_quality)(scene, scene_quality as c_int);
            (functions.set_scene_flags)(scene, flags as c_int);
            (functions.set_geometry_quality)(geometry, geometry_quality as c_int);
            (functions.attach_geometry)(scene, geometry);
        }
        made.device.check()?;
        Ok(made)
    }

    /// Whether it was given no triangles yet.
    pub(super) fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The device.
    pub(super) fn device(&self) -> &Device {
        &self.device
    }

    /// Gives the scene new positions, and new triangles if there are any, and
    /// updates its tree. `padded` holds one position more than triangles name,
    /// since the library reads 16 bytes at each; it has to be there, unchanged, for as long
    /// as the result is in use.
    pub(super) fn commit<'s>(
        &'s mut self,
        padded: &'s [[f32; 3]],
        triangles: Option<&[[u32; 3]]>,
    ) -> Result<Committed<'s>, String> {
        let functions = &self.device.embree.functions;
        let geometry = self.geometry;
        let count = padded.len().saturating_sub(1);
        if let Some(triangles) = triangles {
            self.triangles.clear();
            self.triangles.extend_from_slice(triangles);
        }
        // SAFETY: both buffers have the layout and the size that is told, and the
        // positions a spare element behind the last. The triangles live as long as the scene;
        // the positions are borrowed by the result, and no query is made after it is gone until
        // the next commit has replaced them.
        unsafe {
            let share = |kind, format, data: *const c_void, count| {
                (functions.set_shared_buffer)(geometry, kind, 0, format, data, 0, 12, count);
            };
            share(
                BUFFER_TYPE_VERTEX,
                FORMAT_FLOAT3,
                padded.as_ptr().cast(),
                count,
            );
            if triangles.is_some() {
                let data = self.triangles.as_ptr().cast();
                share(BUFFER_TYPE_INDEX, FORMAT_UINT3, data, self.triangles.len());
            }
            (functions.commit_geometry)(geometry);
            (functions.commit_scene)(self.scene);
        }
        self.device.check()?;
        Ok(Committed {
            scene: self,
            _positions: padded,
        })
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        let functions = &self.device.embree.functions;
        // SAFETY: what is there is alive; the device is released after it.
        unsafe {
            if !self.geometry.is_null() {
                (functions.release_geometry)(self.geometry);
            }
            if !self.scene.is_null() {
                (functions.release_scene)(self.scene);
            }
        }
    }
}

/// A scene that can be traced.
pub(super) struct Committed<'s> {
    scene: &'s Scene,
    /// Read by queries.
    _positions: &'s [[f32; 3]],
}

/// Packets of a width that the library has.
pub(super) trait Packet {
    /// Finds the closest hits of all valid lanes.
    fn intersect(committed: &Committed<'_>, hits: &mut Self::Hits, coherence: Coherence);
    /// Sets the far distance of each valid lane to minus infinity if it hits anything.
    fn occluded(committed: &Committed<'_>, rays: &mut Aligned<Self>, coherence: Coherence)
    where
        Self: Sized;
    /// Rays with their hits.
    type Hits;
}

macro_rules! packets {
    ($($width:literal $intersect:ident $occluded:ident;)*) => {$(
        impl Packet for Rays<$width> {
            type Hits = RayHits<$width>;

            #[inline(always)]
            fn intersect(committed: &Committed<'_>, hits: &mut RayHits<$width>, coherence: Coherence) {
                let scene = committed.scene;
                let arguments = QueryArguments::new(coherence);
                let valid = hits.rays.valid();
                // SAFETY: the scene is committed and everything lies as the headers have it.
                unsafe {
                    (scene.device.embree.functions.$intersect)(&valid, scene.scene, hits, &arguments);
                }
            }

            #[inline(always)]
            fn occluded(committed: &Committed<'_>, rays: &mut Aligned<Self>, coherence: Coherence) {
                let scene = committed.scene;
                let arguments = QueryArguments::new(coherence);
                let valid = rays.0.valid();
                // SAFETY: as above.
                unsafe {
                    (scene.device.embree.functions.$occluded)(&valid, scene.scene, rays, &arguments);
                }
            }
        }
    )*};
}

packets! {
    8 intersect_8 occluded_8;
    16 intersect_16 occluded_16;
}

impl Packet for Rays<1> {
    type Hits = RayHits<1>;

    #[inline(always)]
    fn intersect(committed: &Committed<'_>, hits: &mut RayHits<1>, coherence: Coherence) {
        let scene = committed.scene;
        let arguments = QueryArguments::new(coherence);
        // SAFETY: the scene is committed and everything lies as the headers have it.
        unsafe {
            (scene.device.embree.functions.intersect_1)(scene.scene, hits, &arguments);
        }
    }

    #[inline(always)]
    fn occluded(committed: &Committed<'_>, rays: &mut Aligned<Self>, coherence: Coherence) {
        let scene = committed.scene;
        let arguments = QueryArguments::new(coherence);
        // SAFETY: as above.
        unsafe {
            (scene.device.embree.functions.occluded_1)(scene.scene, rays, &arguments);
        }
    }
}
