//! The LMB filter of multisensor-lmb-filters-rs on detections from standard input, for `bench_peers.py`.
//!
//! Argument: `lbp` or `gibbs`, with the library's own limits. Input, numbers apart by white space: F (4 x 4),
//! Q (4 x 4), R (2 x 2); p_S, p_D, clutter per scan, area; number of births, their probability, and of each the
//! mean (4) and the covariance (4 x 4); number of scans, and of each the number of detections and these.
//! Output, a line for each scan: CPU nanoseconds, then birth scan, birth place, x and y of every estimate.

use std::io::{self, Read, Write};

use multisensor_lmb_filters_rs::lmb::{
    AssociationConfig, BirthLocation, BirthModel, Filter, LmbFilter, MotionModel, SensorModel,
};
use multisensor_lmb_filters_rs::{Associator, GibbsAssociator, LbpAssociator};
use nalgebra::{DMatrix, DVector};
use rand::rngs::StdRng;
use rand::SeedableRng;

const GIBBS_SAMPLES: usize = 1000;

struct Numbers(std::vec::IntoIter<f64>);

impl Numbers {
    fn one(&mut self) -> f64 {
        self.0.next().expect("the input ends too early")
    }
    fn count(&mut self) -> usize {
        self.one() as usize
    }
    fn vector(&mut self, n: usize) -> DVector<f64> {
        DVector::from_iterator(n, (0..n).map(|_| self.one()))
    }
    fn matrix(&mut self, n: usize) -> DMatrix<f64> {
        let values: Vec<f64> = (0..n * n).map(|_| self.one()).collect();
        DMatrix::from_row_slice(n, n, &values)
    }
}

fn cpu_ns() -> i64 {
    let mut t = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut t) };
    t.tv_sec * 1_000_000_000 + t.tv_nsec
}

fn run<A: Associator>(mut of: Numbers, config: AssociationConfig, associator: A) {
    let (f, q, r) = (of.matrix(4), of.matrix(4), of.matrix(2));
    let (survival, detection, clutter, area) = (of.one(), of.one(), of.one(), of.one());
    let mut h = DMatrix::zeros(2, 4);
    h[(0, 0)] = 1.0;
    h[(1, 1)] = 1.0;
    let n_births = of.count();
    let probability = of.one();
    let places = (0..n_births)
        .map(|i| BirthLocation::new(i, of.vector(4), of.matrix(4)))
        .collect();
    let mut filter = LmbFilter::with_associator_type(
        MotionModel::new(f, q, DVector::zeros(4), survival),
        SensorModel::new(h, r, detection, clutter, area),
        BirthModel::new(places, probability, probability),
        config,
        associator,
    );
    let mut rng = StdRng::seed_from_u64(1);
    let mut out = io::BufWriter::new(io::stdout());
    for k in 0..of.count() {
        let n = of.count();
        let scan: Vec<DVector<f64>> = (0..n).map(|_| of.vector(2)).collect();
        let begin = cpu_ns();
        let found = filter.step(&mut rng, &scan, k).expect("the filter refuses a scan");
        write!(out, "{}", cpu_ns() - begin).unwrap();
        for track in &found.tracks {
            let (label, x) = (&track.label, &track.mean);
            write!(out, " {} {} {} {}", label.birth_time, label.birth_location, x[0], x[1]).unwrap();
        }
        writeln!(out).unwrap();
    }
}

fn main() {
    let mut text = String::new();
    io::stdin().read_to_string(&mut text).expect("cannot read the input");
    let numbers: Vec<f64> = text
        .split_ascii_whitespace()
        .map(|word| word.parse().expect("expected a number"))
        .collect();
    let of = Numbers(numbers.into_iter());
    match std::env::args().nth(1).as_deref() {
        Some("lbp") => run(of, AssociationConfig::default(), LbpAssociator),
        Some("gibbs") => run(of, AssociationConfig::gibbs(GIBBS_SAMPLES), GibbsAssociator),
        _ => panic!("expected lbp or gibbs"),
    }
}
