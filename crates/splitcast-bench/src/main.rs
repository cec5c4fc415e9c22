fn main() {
    let scene = std::env::args().nth(1).unwrap();
    let choice: Vec<String> = std::env::args().skip(3).collect();
    let threads: usize = std::env::args().nth(2).unwrap().parse().unwrap();
    let catalog = splitcast_bench::Catalog::new().choose(&choice).unwrap();
    for missing in &catalog.missing {
        println!("{missing}");
    }
    for e in &catalog.entries {
        println!("{}: {}", e.name, e.about);
    }
    let mut source = splitcast_scene::builtin::open(&scene).unwrap();
    let info = splitcast_scene::SequenceInfo::measure(&mut *source).unwrap();
    let b = info.bounds.unwrap();
    let view =
        splitcast_render::Perspective::framing(&info.outline, [0., 1., 0.], 640. / 480., 24.)
            .unwrap();
    let picture = splitcast_bench::Picture {
        camera: splitcast_render::Camera::new(&view).unwrap(),
        width: 640,
        height: 480,
        bounds: splitcast::Aabb {
            min: b.min,
            max: b.max,
        },
    };
    let plan = splitcast_bench::Plan {
        rays: splitcast_bench::RaySetKind::ALL.to_vec(),
        threads,
        every: 8,
        rounds: 1,
    };
    let pool = splitcast_bench::pool(threads).unwrap();
    let m = pool
        .install(|| {
            splitcast_bench::measure(
                &mut *source,
                &catalog.entries,
                &picture,
                &plan,
                &mut |a, b| eprint!("\r{a}/{b}"),
            )
        })
        .unwrap();
    for s in &m.systems {
        let mut u: Vec<f64> = s.updates.iter().map(|u| u.update_ms).collect();
        u.sort_by(f64::total_cmp);
        print!(
            "{:18} {:8.2} {:8.2} {:6} KB ",
            s.name,
            u[u.len() / 2],
            u[u.len() - 1],
            s.bytes / 1024
        );
        for k in 0..5 {
            let mut r: Vec<f64> = s
                .updates
                .iter()
                .filter(|u| !u.traces.is_empty())
                .map(|u| u.traces[k].rays as f64 / u.traces[k].ms / 1e3)
                .collect();
            r.sort_by(f64::total_cmp);
            print!(" {:7.2}", r[r.len() / 2]);
        }
        let sah: Vec<f64> = s.updates.iter().filter_map(|u| u.sah_cost).collect();
        println!(
            " {:?} {:?} {}",
            sah.last(),
            s.modes,
            s.failure.as_deref().unwrap_or("")
        );
        for a in &s.agreement {
            println!("     {:?} {}", a, a.agrees());
        }
    }
}
