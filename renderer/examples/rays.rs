//! Rays a second on a mesh of a million triangles, and the memory of its hierarchy, for
//! `bench/meshes/run.sh`: prints a line of JSON.
//!
//!   rays MESH_OUT RAYS_OUT
//!
//! Writes the vertices and indices of the mesh, and the rays, as 32-bit numbers, for peers to trace.

#![allow(clippy::print_stdout, reason = "the figures are what this is for")]

#[path = "../tests/shapes/mod.rs"]
mod shapes;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use renderer::geometry::{BackendChoice, Geometry, Ray, TracedMesh, Triangles};
use renderer::vector::Vec3;
use std::{env, error::Error, fs, sync::Arc, time::Instant};

/// Rays of each kind.
const RAYS: usize = 400_000;
/// The median of these rounds counts.
const ROUNDS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [mesh_out, rays_out] = &arguments[..] else {
        return Err("usage: rays MESH_OUT RAYS_OUT".into());
    };
    let shape = shapes::torus(1000, 500, 1.0, 0.4);
    let rays = rays();
    write(mesh_out, rays_out, &shape, &rays)?;
    let before = resident_kib()?;
    let triangles = Triangles::new(shape.positions.into(), shape.triangles.into())?;
    let began = Instant::now();
    let mesh = TracedMesh::new(triangles, BackendChoice::Embree)?;
    let build_seconds = began.elapsed().as_secs_f64();
    let mebibytes = (resident_kib()? - before) / 1024.0;
    let geometry = Geometry::with_mesh(Vec::new(), Arc::new(mesh))?;
    let mut hits = 0;
    let mut seconds: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let began = Instant::now();
            let met = rays
                .iter()
                .filter(|ray| geometry.intersect(ray, None).is_some());
            hits = met.count();
            began.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    let rate = rays.len() as f64 / seconds[ROUNDS / 2];
    println!(
        "{{\"rays_a_second\": {rate:.0}, \"build_seconds\": {build_seconds:.2}, \"mebibytes\": \
         {mebibytes:.0}, \"hits\": {hits}}}"
    );
    Ok(())
}

/// Half from afar into the box of the mesh, half between points of the box.
fn rays() -> Vec<Ray> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut point = |half: [f64; 3]| {
        let [x, y, z] =
            half.map(|half| half * (2.0 * f64::from(random.next_u32()) / 4_294_967_296.0 - 1.0));
        Vec3::new(x, y, z)
    };
    (0..RAYS)
        .map(|number| {
            let origin = if number % 2 == 0 {
                Vec3::new(0.0, -3.0, 3.0)
            } else {
                point([1.4, 1.4, 0.4])
            };
            let direction = (point([1.4, 1.4, 0.4]) - origin).normalized();
            Ray { origin, direction }
        })
        .collect()
}

fn write(
    mesh_out: &str,
    rays_out: &str,
    shape: &shapes::Shape,
    rays: &[Ray],
) -> Result<(), Box<dyn Error>> {
    let bytes = |vector: &Vec3| <[f64; 3]>::from(*vector).map(|x| (x as f32).to_le_bytes());
    let mut mesh: Vec<u8> = (shape.positions.len() as u32).to_le_bytes().to_vec();
    mesh.extend(shape.positions.iter().flat_map(bytes).flatten());
    mesh.extend(
        shape
            .triangles
            .as_flattened()
            .iter()
            .flat_map(|at| at.to_le_bytes()),
    );
    fs::write(mesh_out, mesh)?;
    let both = |ray: &Ray| [bytes(&ray.origin), bytes(&ray.direction)];
    let rays: Vec<u8> = rays.iter().flat_map(both).flatten().flatten().collect();
    Ok(fs::write(rays_out, rays)?)
}

/// The memory of this process that is resident.
fn resident_kib() -> Result<f64, Box<dyn Error>> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    Ok(line
        .ok_or("no VmRSS")?
        .trim()
        .trim_end_matches(" kB")
        .parse()?)
}
